#define ROWS 5
#define PITCH (150 + 50)
enum { FIRST, SECOND = 4, THIRD };
static const double QUICK = 2.5 * 40;
const long far_away = 1 << 14;
GT_LnXY(1, 10*1000, ROWS * PITCH, QUICK, 2, 0, 0);
GT_LnXY((short)1, 8, far_away, 100/8, (double)1/4, 0, 0);
GT_LnXY(1, -(far_away), 0x7f, 1e1, 7/2*.5, 0, 0);
GT_LnXY(1, THIRD, (long)12.9, 25.f, 2, 0, 0);
