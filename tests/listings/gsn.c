rtn = GTN_CrdClear(1, 1, 0);
rtn = GTN_BufLaserPrfCmd(1, 1, 45, 0, 0);
rtn = GTN_BufLaserOn(1, 1, 0, 0);
rtn = GTN_LnXY(1, 1, 12000, 0, 70, 1.5, 0, 0);
rtn = GTN_BufLaserOff(1, 1, 0, 0);
rtn = GTN_CrdStart(1, 1, 0);
