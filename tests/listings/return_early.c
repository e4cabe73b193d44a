GT_LnXY(1, 100, 0, 50, 2, 0, 0);
return 0;                                        // error: GJ117
GT_LnXY(1, 200, 0, 50, 2, 0, 0);
