// What a variable's type makes of a number.
long whole = 10.7;
unsigned char low = 44.9;
float third = 1.0 / 3;
double half = 1 / 2, real_half = 1 / 2.0;
GT_LnXY(1, whole, low, third, real_half, half, 0);
