// The first line only names the call.
printf("GT_LnXY(1, 1, 1, 50, 2, 0, 0)");
commandhandler("GT_BufLaserOff(1,0,0);", GT_LnXY(1, 2, 2, 50, 2, 0, 0));
