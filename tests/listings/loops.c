while (left > 0) GT_LnXY(1, 100, 100, 50, 2, 0, 0);               // error: GJ117
for (i = 0; i < 8; i++) GT_LnXY(1, 100 * i, 0, 50, 2, 0, 0);      // error: GJ117
do { GT_LnXY(1, 0, 0, 50, 2, 0, 0); } while (!quiet);             // error: GJ117
