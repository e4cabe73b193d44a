extern short GT_LnXY(short crd, long x, long y, double v, double a, double e, short fifo);  // error: ?
n = sizeof(GT_CrdClear(1, 0));                   // error: ?
assert(GT_LnXY(1, 1, 1, 50, 2, 0, 0) == 0);      // error: ?
GT_CrdClear;                                     // error: ?
