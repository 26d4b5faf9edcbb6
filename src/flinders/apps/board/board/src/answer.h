/* Declarations shared by the files of the board's calibrator. */
#ifndef FLINDERS_ANSWER_H
#define FLINDERS_ANSWER_H

#include "flinders_board.h"
#include "residuals.h"

void fl_answer_of(const fl_surface *surface, real noise, flinders_answer *answer);

#endif
