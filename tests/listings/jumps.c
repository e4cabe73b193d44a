GT_LnXY(1, 100, 0, 50, 2, 0, 0);
goto out;                                        // error: GJ117
GT_LnXY(1, 200, 0, 50, 2, 0, 0);
out:                                             // error: GJ117
GT_LnXY(1, 300, 0, 50, 2, 0, 0);
