/** Rates of what the page shows, as conventions/rates.py has them. */

export const FPS = 30; // motion frames per second
