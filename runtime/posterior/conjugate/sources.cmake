set(sources conjugate_posterior.cpp scale_regression.cpp affine.cpp report.cpp)
