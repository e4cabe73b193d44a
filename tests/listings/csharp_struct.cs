// The C# struct has a field for each element.
mc.TCrdPrm prm = new mc.TCrdPrm();
prm.dimension = 2;
prm.profile1 = 1;
prm.profile2 = 2;
prm.synVelMax = 400;
prm.synAccMax = 4;
prm.originPos2 = 30;
rtn = mc.GT_SetCrdPrm(1, ref prm);
