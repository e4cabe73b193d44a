// Without its last argument the second call has the length of one for a single card, but not the third.
GT_CrdClear(0, 1, 0);
GT_LnXY(0, 1, 20000, 30, 50, 2, 0);
GT_BufLaserPrfCmd(0, 1, 35.5);
