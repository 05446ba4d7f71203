"""The chips from the other end of the wire, in lockstep virtual time, decoded by code of their own."""
