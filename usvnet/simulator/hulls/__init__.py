"""Boats: a shape, fittings and paint for each family of hulls, and the user's own mesh."""
