"""Drivers, one small file each."""
