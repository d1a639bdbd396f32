// All that COLMAP's ports ask of Ceres for plain doubles.
#pragma once

#include <cmath>

namespace ceres {
using std::abs;
}
