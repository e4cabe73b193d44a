long x = 100, y = 200, box[4] = {1, 2, 3, 4};
AskTarget(&x);
GT_LnXY(1, x, y, 50, 2, 0, 0);                   // error: GJ114
FillBox(box);
GT_LnXY(1, box[0], y, 50, 2, 0, 0);              // error: GJ114
GT_GetCrdPos(1, where);
GT_LnXY(1, where[0], y, 50, 2, 0, 0);            // error: GJ114
