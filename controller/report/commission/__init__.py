"""Reports a commissioning in words, pictures and one page."""
