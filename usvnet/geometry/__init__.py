"""Cameras, water and the ranges between them."""
