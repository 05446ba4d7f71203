"""Pages and exports: previews and verify reports as one self-contained HTML file, traces for other tools."""
