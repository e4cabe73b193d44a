long x = 100;
Watch(&x);
x = 300;
Step();                                          // error: GJ118
GT_LnXY(1, x, 0, 50, 2, 0, 0);                   // error: GJ114
