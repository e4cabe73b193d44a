printf("/* not a comment"); GT_LnXY(1, 100, 0, 50, 2, 0, 0); printf("*/");
printf("http://example.com/a"); GT_LnXY(1, 200, 0, 50, 2, 0, 0);
printf("\"/*"); GT_LnXY(1, 300, 0, 50, 2, 0, 0); // */
GT_LnXY(1, /* 9, "*/ 400, 0, 50, 2, 0, 0); /* " */
