"""A commissioning in words, pictures and one page."""
