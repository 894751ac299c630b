"""Examines a bus and its servos without driving them: the basis of scan and doctor."""
