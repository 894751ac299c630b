"""The paper (Gil et al., ICRA 2007) again: its table and figures, by theory and simulation."""
