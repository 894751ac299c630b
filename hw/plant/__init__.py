"""How a servo moves: exact motion of one body or of many, a hand, an encoder."""
