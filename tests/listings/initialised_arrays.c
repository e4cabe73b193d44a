long corner[] = {100, 200, 300}, rest[4] = {7};
static const double speed[2] = {12.5, 40};
GT_LnXY(1, corner[2], corner[0], speed[1], speed[0], 0, 0);
GT_LnXY(1, rest[0], rest[3], speed[0], 2, 0, 0);
