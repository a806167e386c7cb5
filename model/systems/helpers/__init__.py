"""Networks that systems and evaluation use: L_m's encoder, classifiers, the speech encoder; may
import
what systems may."""
