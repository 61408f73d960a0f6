"""Evidence: frames of discernment, belief masses, rules of combination, decisions."""
