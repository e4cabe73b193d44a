if (mirror) { GT_LnXY(1, -500, 0, 50, 2, 0, 0); } else { GT_LnXY(1, 500, 0, 50, 2, 0, 0); }  // error: GJ117
