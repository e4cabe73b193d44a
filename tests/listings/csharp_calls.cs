short run; int segment;
rtn = mc.GT_CrdClear(1, 0);
rtn = mc.GT_LnXY(1, 500, 0, 50, 2, 0, 0);
rtn = mc.GT_CrdStart(1, 0);
rtn = mc.GT_CrdStatus(1, out run, out segment, 0);
