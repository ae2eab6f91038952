import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.camera import make_camera
from usvnet.geometry.lens import distort, distortion_jacobian, undistort


def everywhere_px() -> torch.Tensor:
    u, v = torch.meshgrid(torch.arange(0.0, 640, 8), torch.arange(0.0, 480, 8), indexing="ij")
    return torch.stack([u, v], -1).reshape(1, -1, 2).double()


@pytest.mark.parametrize(
    ("focal_px", "distortion"),
    [
        (536, (-0.27, -0.04, 0.002, -0.0003, 0.25)),
        (400, (-0.3, 0.1, 0, 0, 0)),
        (400, (0.3, 0.1, 0, 0, 0)),
        (700, (0, 0, 0, 0, 0)),
    ],
)
@pytest.mark.parametrize(("dtype", "error_px"), [(torch.float32, 5e-4), (torch.float64, 1e-6)])
def test_undistort_inverts_distort_all_over_the_picture(focal_px, distortion, dtype, error_px):
    camera = make_camera(
        [[focal_px, 0, 319.5], [0, focal_px, 239.5], [0, 0, 1]], (640, 480), distortion, height_m=1, dtype=dtype
    )
    pixels = everywhere_px().to(dtype)
    lens = undistort(pixels, camera)
    assert lens.valid.all()
    again = distort(lens.xy, camera.distortion) * focal_px + camera.K[:, None, :2, 2]
    assert (again - pixels).abs().max() < error_px


def test_jacobian_is_the_derivative_of_distort(camera):
    torch.manual_seed(0)
    xy = (torch.rand(1, 5, 2, dtype=torch.float64) - 0.5).requires_grad_()
    expected = torch.autograd.functional.jacobian(lambda xy: distort(xy, camera.distortion).sum(1), xy)[0]
    torch.testing.assert_close(distortion_jacobian(xy, camera.distortion)[0], expected[:, 0].movedim(1, 0))


def test_inverse_jacobian_is_the_derivative_of_undistort(camera, water_px):
    expected = torch.autograd.functional.jacobian(lambda points: undistort(points, camera).xy.sum(1), water_px)[0]
    focal = torch.stack([camera.K[0, 0, 0], camera.K[0, 1, 1]])
    inverse = undistort(water_px, camera).inverse_jacobian[0]
    torch.testing.assert_close(inverse / focal, expected[:, 0].movedim(1, 0))


def test_beyond_the_fold_of_the_lens_there_is_no_ray():
    # With k1 alone the distorted radius r (1 + k1 r^2) peaks at r = 1 / sqrt(-3 k1), at two thirds of that r.
    camera = make_camera([[500, 0, 0], [0, 500, 0], [0, 0, 1]], (640, 480), (-0.3, 0, 0, 0), height_m=1)
    peak_px = 500 * 2 / 3 / 0.9**0.5
    pixels = torch.tensor([[[0.8 * peak_px, 0.0], [1.05 * peak_px, 0.0], [0.0, 3 * peak_px], [1e6, 1e6]]])
    assert undistort(pixels, camera).valid.tolist() == [[True, False, False, False]]


def test_a_ray_found_beyond_the_fold_is_no_ray():
    # A calibration that turns over at the picture's edge: the iteration settles on the far side, where it runs inwards.
    distortion = (0.53, 0.39, -0.016, -0.008, -0.37)
    camera = make_camera([[100, 0, 0], [0, 100, 0], [0, 0, 1]], (640, 480), distortion, height_m=1, dtype=torch.float64)
    pixels = torch.cartesian_prod(torch.linspace(-200, 200, 101).double(), torch.linspace(-200, 200, 101).double())
    anywhere = undistort(pixels[None], camera, min_determinant=-torch.inf)
    trusted = undistort(pixels[None], camera)
    assert (torch.det(anywhere.inverse_jacobian[anywhere.valid]) < 0).any()
    assert (torch.det(trusted.inverse_jacobian[trusted.valid]) > 0).all()
    assert trusted.valid.sum() > 4000


def test_pixels_near_the_fold_of_a_wide_lens_have_their_rays():
    camera = make_camera([[700, 0, 640], [0, 700, 360], [0, 0, 1]], (1280, 720), (-0.35, 0.15, 0, 0, -0.03), height_m=1)
    pixels = torch.tensor([[[1261.0, 552.0], [1266.0, 570.0]]])
    lens = undistort(pixels, camera)
    assert lens.valid.all()
    assert (distort(lens.xy, camera.distortion) * 700 + torch.tensor([640.0, 360.0]) - pixels).abs().max() < 1e-3


def test_a_point_across_the_centre_is_no_ray():
    # Far beyond the fold x_d = x (1 + k1 x^2) is of the other sign and grows again: each pixel has a point there, too.
    camera = make_camera([[500, 0, 0], [0, 500, 0], [0, 0, 1]], (640, 480), (-0.3, 0, 0, 0), height_m=1)
    pixels = torch.cartesian_prod(torch.linspace(-700, 700, 141), torch.linspace(-500, 500, 101))[None]
    lens = undistort(pixels, camera)
    assert ((lens.xy * pixels).sum(-1) >= 0)[lens.valid].all()
    assert (pixels.norm(dim=-1)[lens.valid] < 500 * 2 / 3 / 0.9**0.5).all()


def test_gradcheck(camera, water_px):
    points = water_px.requires_grad_()
    K = camera.K.clone().requires_grad_()
    distortion = camera.distortion.clone().requires_grad_()

    def undistorted(points, K, distortion):
        return undistort(points, camera._replace(K=K, distortion=distortion))[:3]

    assert gradcheck(undistorted, (points, K, distortion))
    xy = (torch.rand(1, 4, 2, dtype=torch.float64) - 0.5).requires_grad_()
    assert gradcheck(distort, (xy, distortion))
    assert gradcheck(distortion_jacobian, (xy, distortion))
