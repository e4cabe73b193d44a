// Two speeds, chosen before: only one of the lines is drawn.
GT_CrdClear(1, 0);
GT_BufLaserOn(1, 0, 0);
if (coarse) GT_LnXY(1, 20000, 0, 120, 3, 0, 0);   // error: GJ117
else GT_LnXY(1, 20000, 0, 40, 3, 0, 0);
GT_BufLaserOff(1, 0, 0);
