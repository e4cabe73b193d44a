TCrdPrm prm = {0};
prm.dimension = 2;
prm.synVelocityMax = 400;                        // error: GJ152
GT_SetCrdPrm(1, &prm);
