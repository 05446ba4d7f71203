"""Chips and wire: packets, fact tables, bus, start-up, executor. Knows counts, steps and ns; no mm and no G-code."""
