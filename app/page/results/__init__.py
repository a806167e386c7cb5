"""How a run looks on the page: player, time line, figures, table; may import serving and parts."""
