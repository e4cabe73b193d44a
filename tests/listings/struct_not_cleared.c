TCrdPrm prm;
prm.dimension = 2;
prm.synVelMax = 400;
GT_SetCrdPrm(1, &prm);                           // error: GJ114
