short far_away = 70000;
unsigned char low = 300;
GT_LnXY(1, far_away, 0, 50, 2, 0, 0);            // error: GJ114
GT_LnXY(1, 0, low, 50, 2, 0, 0);                 // error: GJ114
