GT_LnXY(1, 4000, 0, 50, 2, 0, 0);
if (again)                                       // error: GJ117
    GT_LnXY(1, 0, 0, 50, 2, 0, 0);
GT_LnXY(1, 9000, 0, 50, 2, 0, 0);
