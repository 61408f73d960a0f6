"""Attributes: RCS models, frames of discernment, rules, decisions and attribute fusion."""
