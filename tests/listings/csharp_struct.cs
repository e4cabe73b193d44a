// Its arrays are null until the program makes them.
mc.TCrdPrm prm = new mc.TCrdPrm();
prm.dimension = 2;
prm.synVelMax = 400;
prm.synAccMax = 4;
rtn = mc.GT_SetCrdPrm(1, ref prm);               // error: GJ114
