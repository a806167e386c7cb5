"""How a run looks on the page around its player: tables, figures, files; may import the player."""
