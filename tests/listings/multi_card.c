TCrdPrm prm = {2, {1, 2}, 300, 3};
GT_SetCrdPrm(0, 1, &prm);
GT_CrdClear(0, 1, 0);
GT_BufLaserOn(0, 1, 0, 0);
GT_LnXY(0, 1, 20000, 30, 50, 2, 0, 0);
GT_BufLaserOff(0, 1, 0, 0);
GT_CrdStart(0, 1, 0);
