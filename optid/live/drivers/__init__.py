"""The doors to rigs, one small file each."""
