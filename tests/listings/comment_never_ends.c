GT_LnXY(1, 100, 0, 50, 2, 0, 0);
/* the rest
GT_LnXY(1, 200, 0, 50, 2, 0, 0);
