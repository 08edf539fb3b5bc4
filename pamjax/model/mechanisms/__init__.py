"""Mechanisms that a model may include, one file for each."""
