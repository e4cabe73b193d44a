double power = 20;
GT_BufLaserPrfCmd(1, power, 0, 0);
power = ReadDial();
GT_LnXY(1, 100, 0, 50, 2, 0, 0);
GT_BufLaserPrfCmd(1, power, 0, 0);               // error: GJ114
power = 30;
GT_BufLaserPrfCmd(1, power, 0, 0);
