// speeds /* pulse/ms
GT_LnXY(1, 100, 0, 50, 2, 0, 0);
// accelerations */
GT_LnXY(1, 200, 0, 50, 2, 0, 0); // all of GT_*/
GT_LnXY(1, 300, 0, 50, 2, 0, 0);
/* // */ GT_LnXY(1, 400, 0, 50, 2, 0, 0);
