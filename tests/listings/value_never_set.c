GT_LnXY(1, start_x, 0, 50, 2, 0, 0);             // error: GJ114
