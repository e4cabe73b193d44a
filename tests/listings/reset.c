GT_LaserPowerMode(0, 100, 0, 0);
GT_LaserOutFrq(20, 0);
GT_Reset();
GT_BufLaserOn(1, 0, 0);
GT_LnXY(1, 100, 0, 50, 2, 0, 0);
