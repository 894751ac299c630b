"""Serial ports: opens one for this program alone, transfers bytes, finds other users."""
