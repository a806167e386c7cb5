"""Body model: file, skinning, look and joints; imports no other room of `renderer`."""
