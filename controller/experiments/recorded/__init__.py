"""Fits servo, friction and load to a motion that was recorded elsewhere."""
