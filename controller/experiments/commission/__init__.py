"""Commissions a testbed: examines, identifies and measures it, and says how stiff it can be."""
