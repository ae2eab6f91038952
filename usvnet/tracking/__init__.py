"""Boats over time: which is which from frame to frame, where each is going, and how near it will come."""
