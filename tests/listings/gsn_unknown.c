GTN_LnXY(1, 1, 500, 0, 70, 1.5, 0, 0);
GTN_SetLaserDisMode(1, 1, 0, pos, scale, 0);     // error: GJ120
GTN_ScanLaserOn(1, 1);                           // error: GJ120
