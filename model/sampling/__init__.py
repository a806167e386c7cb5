"""From noise to data: flow matching and the linear-Gaussian prior; imports no other room."""
