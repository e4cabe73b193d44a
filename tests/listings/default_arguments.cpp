GT_LaserPowerMode(0, 100, 0, 0, 0);
GT_LaserOutFrq(20);
GT_BufLaserOn(1);
GT_BufLaserPrfCmd(1, 40);
GT_LnXY(1, 9000, 4000, 50, 2);
GT_LnXY(1, 0, 0, 50, 2, 5);
GT_BufDelay(1, 2);
GT_BufLaserOff(1, 1);
