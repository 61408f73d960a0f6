"""What is wrong with a live system: looked at once, then judged by plain functions."""
