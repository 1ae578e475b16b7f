"""Problems with known answers, solved by the heart's elements and the heart's solver."""
