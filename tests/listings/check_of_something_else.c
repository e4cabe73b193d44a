rtn = GT_LnXY(1, 100, 0, 50, 2, 0, 0);
rtn = 5;
if (rtn) return 1;                               // error: GJ117
GT_LnXY(1, 200, 0, 50, 2, 0, 0);
if (door) return 2;                              // error: GJ117
GT_LnXY(1, 300, 0, 50, 2, 0, 0);
