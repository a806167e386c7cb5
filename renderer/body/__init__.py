"""Body model: file, skinning, look and joints; imports no other package of `renderer`."""
