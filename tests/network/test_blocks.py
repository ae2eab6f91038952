"""The atom of the network: what it computes in training does not depend on how."""

import pytest
import torch
from torch.nn import functional

from usvnet.network.blocks import Enter, Pointwise


@pytest.mark.parametrize("bias", [False, True])
def test_a_pointwise_layer_trains_as_the_convolution_that_it_is(bias: bool):
    """torch.nn.functional.conv2d beside it: answer and gradients; the weight's in the layout that DDP asks for."""
    torch.manual_seed(0)
    layer = Pointwise(6, 10, bias).double().to(memory_format=torch.channels_last)
    x = torch.randn(2, 12, 5, 4, dtype=torch.float64).to(memory_format=torch.channels_last)
    halves = [x[:, 6:].detach().requires_grad_() for _ in range(2)]  # a chunk: not dense in memory
    own = list(layer.parameters())
    beside = [parameter.detach().clone().requires_grad_() for parameter in own]
    expected = functional.conv2d(halves[0], *beside)
    found = layer(halves[1])
    torch.testing.assert_close(found, expected)
    slope = torch.randn_like(found)
    expected.backward(slope)
    found.backward(slope)
    torch.testing.assert_close(halves[1].grad, halves[0].grad)
    for ours, theirs in zip(own, beside):
        torch.testing.assert_close(ours.grad, theirs.grad)
    assert layer.weight.grad is not None
    assert layer.weight.grad.stride() == layer.weight.stride()


def test_coarser_features_join_in_training_as_if_enlarged_and_concatenated():
    """torch.nn.functional beside it: answer and all gradients."""
    torch.manual_seed(0)
    layer = Enter(10, 6).double().to(memory_format=torch.channels_last)
    sizes = ((2, 3, 8, 6), (2, 7, 4, 3))
    x, coarse = (torch.randn(size, dtype=torch.float64).to(memory_format=torch.channels_last) for size in sizes)
    own = [tensor.requires_grad_() for tensor in (x, coarse, layer.conv.weight)]
    beside = [tensor.detach().clone().requires_grad_() for tensor in own]
    enlarged = functional.interpolate(beside[1], scale_factor=2.0)
    expected = layer.act(layer.norm(functional.conv2d(torch.cat([enlarged, beside[0]], 1), beside[2])))
    found = layer(x, coarse)
    torch.testing.assert_close(found, expected)
    slope = torch.randn_like(found)
    expected.backward(slope)
    found.backward(slope)
    for ours, theirs in zip(own, beside):
        torch.testing.assert_close(ours.grad, theirs.grad)
    assert layer.conv.weight.grad is not None
    assert layer.conv.weight.grad.stride() == layer.conv.weight.stride()
