ready && GT_BufLaserOn(1, 0, 0);                 // error: GJ117
rtn = big ? GT_LnXY(1, 900, 0, 50, 2, 0, 0) : GT_LnXY(1, 90, 0, 50, 2, 0, 0);  // error: GJ117
GT_BufLaserPrfCmd(1, hot ? 90 : 10, 0, 0);       // error: GJ117
