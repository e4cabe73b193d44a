#define TO(x, y) GT_LnXY(1, x, y, 50, 2, 0, 0)   // error: GJ111
TO(100, 200);
#define GT_BufLaserOff(a, b, c)                  // error: GJ111
GT_BufLaserOff(1, 0, 0);
#define long short                               // error: GJ111
