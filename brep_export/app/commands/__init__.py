"""The commands of `recon`, one module each: what it takes, and which job does its work."""
