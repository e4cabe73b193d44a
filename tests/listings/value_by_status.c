short run = 5;
long segment = 6;
GT_CrdStatus(1, &run, &segment, 0);
GT_LnXY(1, run, 0, 50, 2, 0, 0);                 // error: GJ114
GT_LnXY(1, 0, segment, 50, 2, 0, 0);             // error: GJ114
