"""The stability theory of sampled virtual walls."""
