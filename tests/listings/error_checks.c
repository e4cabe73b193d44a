short rtn;
rtn = GT_CrdClear(1, 0);
if (rtn) return rtn;
rtn = GT_LnXY(1, 100, 0, 50, 2, 0, 0);
if (rtn != 0)
{
    printf("GT_LnXY: %d\n", rtn);
    return -1;
}
if (GT_LnXY(1, 200, 0, 50, 2, 0, 0) != 0) return -2;
if ((rtn = GT_LnXY(1, 300, 0, 50, 2, 0, 0))) { return rtn; }
if (0 != rtn) return rtn;
