"""Conditional-GAN few-step denoising; may import the face and what systems may."""
