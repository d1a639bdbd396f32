// A pinhole in place of COLMAP's lenses, so that its ports compile without the rest of COLMAP.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/LU>
#include <ceres/ceres.h>

#define CAMERA_COMBINATION_MODEL_CASES                       \
  CAMERA_COMBINATION_MODEL_CASE(FlatPort, PinholeCameraModel) \
  CAMERA_COMBINATION_MODEL_CASE(DomePort, PinholeCameraModel)

namespace colmap {

enum class CameraModelId { kPinhole = 1 };

struct PinholeCameraModel {  // parameters: fx, fy, cx, cy
  static constexpr int kModelId = 1;
  static constexpr CameraModelId model_id = CameraModelId::kPinhole;

  template <typename T>
  static bool ImgFromCam(const T* params, T u, T v, T w, T* x, T* y) {
    *x = params[0] * u / w + params[2];
    *y = params[1] * v / w + params[3];
    return true;
  }

  template <typename T>
  static bool CamFromImg(const T* params, T x, T y, T* u, T* v) {
    *u = (x - params[2]) / params[0];
    *v = (y - params[3]) / params[1];
    return true;
  }

  template <typename T>
  static void CamFromImg(const T* params, T x, T y, T* u, T* v, T* w) {
    CamFromImg(params, x, y, u, v);
    *w = T(1);
  }
};

}  // namespace colmap
