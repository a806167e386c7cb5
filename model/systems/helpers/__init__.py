"""Networks that are trained like systems and serve them: L_m's teacher, judges, the speech encoder;
may import what systems may."""
