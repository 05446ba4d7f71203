"""G-code: text to canonical commands. Knows RS274/NGC, its dialects, tools and offsets; no machine and no time."""
