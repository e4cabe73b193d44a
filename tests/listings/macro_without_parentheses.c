#define STEP 2+3
GT_LnXY(1, STEP, 0, 50, 2, 0, 0);
GT_LnXY(1, STEP*2, 0, 50, 2, 0, 0);              // error: GJ114
