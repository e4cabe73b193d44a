GT_BufLaserOn(1,0,0); GT_LnXY(1,100,0,50,2,0,0);GT_LnXY(1,200,0,50,2,0,0) ; ; GT_BufLaserOff(1,0,0);
GT_LnXY (1,
         300,   // x
         0,     /* y */
         50, 2,
         0, 0
        );
rtn
    = GT_BufLaserOff
        (1, 0, 1);
