"""`ttf` and `safer`: what a NaN means that they compare, and which operands may be one."""
