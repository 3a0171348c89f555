"""Report pages: self-contained HTML with pictures as inline SVG, for any screen, light or dark."""
