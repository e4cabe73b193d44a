extern short GT_LnXY(short crd, long x, long y, double v, double a, double e, short fifo);  // error: GJ111
n = sizeof(GT_CrdClear(1, 0));                   // error: GJ117
assert(GT_LnXY(1, 1, 1, 50, 2, 0, 0) == 0);      // error: GJ117
GT_CrdClear;                                     // error: GJ111
