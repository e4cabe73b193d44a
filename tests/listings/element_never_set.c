long to[2];
to[0] = 4000;
GT_LnXY(1, to[0], to[1], 50, 2, 0, 0);           // error: GJ114
