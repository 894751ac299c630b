"""Looking at a bus and its servos without driving them: what scan and doctor are made of."""
