"""ASTERIX, the format of surveillance radars: target reports (048) and service messages (034)."""
