GT_InitLookAhead(1, 0, 5, 1, 200, buffer);       // error: GJ120
GT_LnXYZ(1, 100, 0, 50, 50, 2, 0, 0);            // error: GJ120
GT_BufIO(1, 12, 1, 0, 0);                        // error: GJ120
GT_CrdData(1, &next, 0);                         // error: GJ120
GT_LnXZ(1, 100, 0, 50, 2, 0, 0);                 // error: GJ112
