GT_LnXY(1, 100, 0, 50, 2, 0, 0);
// files are in C:\jobs\
GT_LnXY(1, 200, 0, 50, 2, 0, 0);
GT_LnXY(1, 300, 0, 50, 2, 0, 0);
