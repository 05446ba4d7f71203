"""Canonical commands to path, trajectory and chip commands in time. Knows mm, s, limits and the chips' facts."""
