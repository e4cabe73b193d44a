commandhandler("GT_BufLaserOn", GT_BufLaserOn(1, 0, 0));
CHECK(GT_LnXY(1, 6000, -6000, 80, 2.5, 0, 0));
CHECK( GT_BufDelay(1, 3, 0) ); CHECK(GT_BufLaserOff(1,0,0));
(void)GT_CrdStart(1, 0);
rtn |= GT_CrdStatus(1, &run, &segment, 0);
