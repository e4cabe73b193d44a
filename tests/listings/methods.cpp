card->GT_CrdClear(1, 0);
card->GT_LnXY(1, 500, 0, 50, 2, 0, 0);
googol::GT_BufLaserOff(1, 0, 0);
