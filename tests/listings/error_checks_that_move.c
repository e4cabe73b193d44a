rtn = GT_LnXY(1, 100, 0, 50, 2, 0, 0);
if (rtn) { GT_BufLaserOff(1, 0, 0); }            // error: GJ117
if (!rtn) GT_LnXY(1, 200, 0, 50, 2, 0, 0);       // error: GJ117
if (rtn == 0) return 0;                          // error: GJ117
if (rtn != 1) return 0;                          // error: GJ117
if (rtn) printf("bad"); return 1;                // error: GJ117
if (GT_LnXY(1, 5, 0, 50, 2, 0, 0) || late) return 1;  // error: GJ117
