"""Machine descriptions, the composition root and the session: the only room that sees planner, sim and nmc together."""
